"""Files of the operating system: the calls that write them, files and folders named once whole; knows no log."""
