"""The explorer: a local page on which a board follows the hand."""
