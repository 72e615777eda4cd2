"""Files of the operating system: regular files, files without a name yet, descriptors; knows no log."""
