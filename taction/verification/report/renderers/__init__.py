"""How a page is shown: in a terminal, as HTML, as a picture, in a notebook."""
