"""The paper's simulations and statements, run again: experiments, figures beside the paper's numbers, one page."""
