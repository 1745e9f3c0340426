"""Everything that needs torch: models, drawn scenes, losses, training, export. Never imported by inference."""
