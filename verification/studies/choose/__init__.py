"""Op-amp, C and gain chosen over all presets."""
