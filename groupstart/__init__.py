"""The front doors: command line, reports and the Python API."""
