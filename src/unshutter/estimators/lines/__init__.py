"""Lines in pictures: segments, curves that were lines, what right angles say, and the optimisers that use them."""
