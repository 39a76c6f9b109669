"""The twin behind real protocols: what the drivers talk to where no bench stands."""
