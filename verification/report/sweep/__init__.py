"""A sweep as records, files and maps."""
