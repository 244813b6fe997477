"""Model files, plain and to the last bit, and compressed height maps, every valid pixel within a bound."""

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
