"""The SO log: written append-only while a port is recorded, read back strictly.

Format (UTF-8 CSV)::

    # format: suas-so-log
    # format_version: 1
    # start_time: 2025-11-21T05:40:12.123456+00:00
    # skin: skins/suas.toml
    # scale: 0.305 fF
    # units: t_host_s and t_device_s in seconds, so_k in raw counts (0 to 65535)
    t_host_s,t_device_s,seq,module,so_1,...,so_n[,flag columns]
    0.012345,0.01,1,0,13675,13680,...

`t_host_s` counts from `start_time`; one row is one module in one frame, and the rows of
equal `seq` make a frame. An empty field is a missing value. A log that was cut off loses
its last line only.
"""

from suas_jax.acquisition.log.data import (
    DEFAULT_SCALE,
    FORMAT,
    FORMAT_VERSION,
    KEY_COLUMNS,
    MAX_COUNT,
    UNITS,
    Frames,
    LogFileError,
    SoLog,
    flagged,
    fluid_of,
    group_frames,
    log_header,
    sequence_notes,
    without_other_taxels,
)
from suas_jax.acquisition.log.reader import is_log, read_log
from suas_jax.acquisition.log.writer import LogWriter
from suas_jax.files.line_file import LineWriteError
