"""The paper, claim by claim: `reproduce` runs every claim of ``claims.toml`` and judges it."""
