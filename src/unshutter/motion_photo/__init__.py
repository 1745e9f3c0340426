"""The film inside a photo: estimates the photo's motion from the film frames around the time of exposure."""
