"""Training: all modules that need torch. They import inference; inference never imports them."""
