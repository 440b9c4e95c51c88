"""The results for one mesh: a row for each file or setting of a peer, and the failures."""
import contextlib, csv, sys, time
from dataclasses import asdict, dataclass, field

START = time.time()


def say(text):
    print(f"{time.time() - START:7.0f} s  {text}", file=sys.stderr, flush=True)


@dataclass
class Row:
    """One file or mesh of a peer. Lengths are in mean edges of the input."""

    peer: str
    setting: str = ""
    cpu: float | None = None  # seconds
    memory: float | None = None  # bytes, of a build
    bytes: int | None = None
    triangles: int | None = None
    rms: float | None = None
    max: float | None = None
    hierarchy: bool = False  # the row is the build of a hierarchy
    writes: bool = False  # ... and it ends in a file
    pyramid: bool = False  # the file streams: a picture of the whole first, then finer parts where needed
    first: tuple | None = None  # requests and bytes for a first picture of the whole

    @property
    def name(self):
        return f"{self.peer} {self.setting}".strip()


@dataclass
class Result:
    """The results for one mesh."""

    mesh: str
    triangles: int
    edge: float  # mean edge length, input units
    ours: Row = field(default_factory=lambda: Row("lodpack"))
    rows: list = field(default_factory=list)
    failures: list = field(default_factory=list)  # (peer, measures it is missing from, why)

    def add(self, *args, distance=None, **values):
        row = Row(*args, **values)
        if distance:
            row.triangles, row.rms, row.max = distance.triangles, distance.rms, distance.max
        self.rows.append(row)
        figures = [f"{row.bytes:,} B" if row.bytes else "", f"{row.triangles:,} triangles" if row.triangles else "",
                   f"RMS {row.rms:.4f} max {row.max:.3f}" if row.rms is not None else "", f"{row.cpu:.2f} CPU s" if row.cpu else ""]
        say(f"{self.mesh}: {row.name}: " + ", ".join(f for f in figures if f))
        return row

    def fail(self, peer, measures, why):
        why = " ".join(str(why).replace("|", "/").split())[-120:]
        say(f"{self.mesh}: {peer}: {why}")
        if (peer, measures, why) not in self.failures:
            self.failures.append((peer, measures, why))

    @contextlib.contextmanager
    def guard(self, peer, *measures):
        """Leaves a failed peer out of these measures; the table says so."""
        try:
            yield
        except Exception as error:
            self.fail(peer, measures, error or type(error).__name__)

    def write_csv(self, path):
        """The table that `lodpack report --peers` reads, with lengths in input units. The report joins rows of one name
        and ignores `setting`."""
        with open(path, "w", newline="") as out:
            table = csv.writer(out, lineterminator="\n")
            table.writerow(["name", "mesh", "cpu_seconds", "bytes", "triangles", "rms", "max", "setting"])
            number = lambda value, scale=1.0: "" if value is None else f"{value * scale:.5g}"
            for row in self.rows:
                whole = ["" if value is None else str(int(value)) for value in (row.bytes, row.triangles)]
                errors = [number(row.rms, self.edge), number(row.max, self.edge)]
                table.writerow([row.peer, self.mesh, number(row.cpu), *whole, *errors, row.setting])

    def json(self):
        return asdict(self)

    @classmethod
    def of_json(cls, values):
        rows, failures = [Row(**row) for row in values["rows"]], [tuple(failure) for failure in values["failures"]]
        return cls(values["mesh"], values["triangles"], values["edge"], Row(**values["ours"]), rows, failures)
