"""Files: measured surfaces in, measured surfaces out; the suffix names the format."""

from ._read import READABLE as READABLE, read as read
from ._stored import OPENABLE as OPENABLE, open_stored as open_stored
from ._write import WRITABLE as WRITABLE, write as write
