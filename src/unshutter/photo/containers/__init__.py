"""How files are put together, where more than one format is put together so."""
