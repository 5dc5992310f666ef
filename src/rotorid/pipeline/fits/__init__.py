"""Ways to fit a model: responses, records, the physics of motors; with searches and bootstraps."""
