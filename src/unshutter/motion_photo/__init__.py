"""The film inside a photo: how the camera moved while the photo was read out, from the frames around its moment."""
