"""What the tests share: pictures that are drawn, files that are made, runs of the program."""
