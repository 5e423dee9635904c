"""report.html: a run as a page for people. One file, no outside resources, figures drawn as inline SVG."""
