"""Model files: a T-spline on disk, plain, versioned, free of pickles and checked on load."""

from ._compress import compress as compress
from ._compressed import CompressedHeader as CompressedHeader
from ._container import (
    MODEL_SUFFIX as MODEL_SUFFIX,
    load as load,
    load_header as load_header,
    save as save,
)
from ._decompress import compressed_header as compressed_header, decompress as decompress
from ._header import ModelHeader as ModelHeader
