"""Projects in a real kicad-cli; `make test-kicad` runs them."""
