"""What each result shows: one file a result, with a function that returns a page."""
