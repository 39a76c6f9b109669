"""Models in other forms: table as CSV, C header, ONNX graph; each with its uncertainty."""
