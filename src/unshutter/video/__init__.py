"""Rectifies clips: decodes frames, undoes their motion and encodes them; everything else in the file is preserved."""
