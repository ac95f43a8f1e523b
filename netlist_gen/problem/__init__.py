"""The inverse problem of a scene: matrix, strain, their files."""
