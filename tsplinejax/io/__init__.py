"""Files: measured surfaces in, measured surfaces out; the suffix names the format."""

from ._read import READABLE as READABLE
from ._read import read as read
from ._write import WRITABLE as WRITABLE
from ._write import write as write
