"""Evidence for taction itself: the claims of the paper, and the catalogue of extreme cases."""
