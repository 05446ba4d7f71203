"""Facts of the chips: one table a chip, every row with the section of the data sheet that says it."""
