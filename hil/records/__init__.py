"""What a run leaves behind: the Arrow files of a run folder, their layouts, writers and readers."""
