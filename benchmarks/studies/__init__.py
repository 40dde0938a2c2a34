"""Studies: experiments on parts of the pipeline, outside the matrix."""
