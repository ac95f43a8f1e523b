"""The languages of other simulators, one file a dialect; `table.DIALECTS` lists them."""
