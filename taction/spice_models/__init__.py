"""Op-amps and signal amplifiers: figures, presets and macromodels."""
