"""Many designs: the points of a study, workers that solve them, and the file of rows that outlives them."""
