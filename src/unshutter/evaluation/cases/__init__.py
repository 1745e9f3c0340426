"""What is measured: pictures, and how an answer is scored."""
