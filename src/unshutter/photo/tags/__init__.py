"""What files say about a photo beside its pixels, one file a standard: read, and kept true when the pixels change."""
