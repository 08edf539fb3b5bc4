"""One recording and every mechanism of the library as one problem."""
