"""Lines in pictures: segments, curves that were lines, and the least squares that straightens them."""
