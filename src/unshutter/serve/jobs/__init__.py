"""Jobs: what the worker processes do with photos and clips. No request, answer or server is known here."""
