"""From a garment mesh to a recording: hung, turned, rendered, measured with noise, with its truth."""
