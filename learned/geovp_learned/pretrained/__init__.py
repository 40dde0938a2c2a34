"""Networks that were trained elsewhere: ONNX files and Hugging Face models."""
