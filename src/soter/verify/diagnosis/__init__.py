"""Why a proof failed, or says little: runs of the model, changes that were tried, figures."""
