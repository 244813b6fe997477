"""Files: measured surfaces in, measured surfaces out; the suffix names the format."""

from ._read import READABLE as READABLE, read as read
from ._write import WRITABLE as WRITABLE, write as write
