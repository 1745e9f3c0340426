"""Local web page for rectifying photos and clips in a browser: compare before and after, then save."""
