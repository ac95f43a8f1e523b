"""One board under the user's hand: values of a few keys, and what they do at once."""
