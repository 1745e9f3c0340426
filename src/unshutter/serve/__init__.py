"""A page for people: photos are dropped into a browser, compared before and after, and saved. On this machine only."""
