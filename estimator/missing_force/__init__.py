"""The force that a model lacks, seen: estimated along the record without a name, drawn, and put into a form."""
