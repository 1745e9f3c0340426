"""Motion from several frames of one camera: what one photo cannot tell, its neighbours can."""
