"""Files of slope distributions: the numbers of a mixture in an .npz, without pickle."""

import io
from pathlib import Path

import numpy as np

from torchms.slopes.mixture import Mixture, checked
from torchms.storage.archives import read_versioned
from torchms.storage.write import write_whole

FORMAT = 1
MOST_BYTES = 64 << 10
REMEDY = "Write it again: Tabulated.from_heights(...).save(path)."


def write(path: str | Path, content: Mixture, force: bool) -> None:
    """Put the mixture at `path`, whole or not at all; FileExistsError for a file that is there, unless `force`."""
    file = io.BytesIO()
    np.savez(file, format=np.array(FORMAT), **content._asdict())
    write_whole(path, file.getvalue(), force)


def read(path: str | Path) -> Mixture:
    """The mixture in the file `path`.

    Raises FileNotFoundError for none, ValueError for a file that is damaged or of another format, or for numbers that
    make no mixture; nothing is unpickled, and no array is read before its size is known to fit.
    """
    path = Path(path)
    arrays = read_versioned(path, MOST_BYTES, FORMAT, "slopes", REMEDY)
    if any(name not in arrays or arrays[name].dtype.kind != "f" for name in Mixture._fields):
        raise ValueError(f"{path.name} holds no slopes: it lacks numbers of {', '.join(Mixture._fields)}. {REMEDY}")
    return checked(*(arrays[name] for name in Mixture._fields), name=f"{path.name}: Tabulated")
