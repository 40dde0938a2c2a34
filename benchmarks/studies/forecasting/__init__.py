"""The study of forecasters on pose files alone: `geovp forecast`."""
