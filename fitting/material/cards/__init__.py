"""Material cards: the fitted law in the files of other programs."""
