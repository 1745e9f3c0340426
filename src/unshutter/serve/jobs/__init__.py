"""What the worker processes do with photos and clips; no request, answer or server is known here."""
