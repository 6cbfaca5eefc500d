"""How the lobes of `Distilled` are made: rows, targets, training, errors; `python -m torchms.approximations.distil`."""
