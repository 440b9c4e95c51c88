"""What can be opened, and what is said of what cannot."""

import contextlib
import io
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import unittest

import lodpack
import numpy as np

from .served import SCAN, SMALL, VECTORS, served


class Opening(unittest.TestCase):
    def assert_same(self, file: lodpack.File) -> None:
        expected = lodpack.open(SMALL).extract()
        np.testing.assert_array_equal(file.extract().positions, expected.positions)
        np.testing.assert_array_equal(file.extract().triangles, expected.triangles)

    def test_paths_bytes_and_files_give_the_same_mesh(self):
        content = SMALL.read_bytes()
        for source in (SMALL, str(SMALL), SMALL.as_uri(), content, bytearray(content), memoryview(content), io.BytesIO(content)):
            with self.subTest(type(source).__name__):
                self.assert_same(lodpack.open(source))
        with open(SMALL, "rb") as buffered, open(SMALL, "rb", buffering=0) as raw:
            self.assert_same(lodpack.open(buffered))
            self.assert_same(lodpack.open(raw))

    def test_an_address_is_read_in_few_requests(self):
        content = SCAN.read_bytes()
        with served(content) as (url, requests):
            file = lodpack.open(url)
            self.assertEqual(requests, ["bytes=0-12287"])
            low, high = file.bounds
            mesh = file.extract(bbox=(low, low + (high - low) / 2), tolerance=file.info()["levels"][0]["certified_error"] / 4)
            self.assertLessEqual(len(requests), 10)
            self.assertEqual(len(requests), file.request_count)
            self.assertGreater(len(mesh.triangles), 0)
            self.assertLess(file.bytes_read, len(content) + 8192)

    def test_files_of_fsspec_are_asked_for_what_is_needed_and_no_more(self):
        fsspec = required("fsspec")
        required("aiohttp")
        with fsspec.open("memory://folder/scan.lodpack", "wb") as out:
            out.write(SMALL.read_bytes())
        self.assert_same(lodpack.open("memory://folder/scan.lodpack"))
        self.assert_same(lodpack.open(fsspec.open("memory://folder/scan.lodpack")))
        with fsspec.open("memory://folder/scan.lodpack", "rb") as file:
            self.assert_same(lodpack.open(file))
        with served(SCAN.read_bytes()) as (url, requests):
            file = lodpack.open(fsspec.open(url))
            file.extract(tolerance=float("inf"))
            ranges = [request for request in requests if request]
            self.assertEqual(ranges[0], "bytes=0-12287")
            self.assertEqual(len(ranges), file.request_count)

    def test_a_closed_file_says_so_and_its_meshes_stay(self):
        with lodpack.open(SMALL) as file:
            mesh = file.extract()
            before = mesh.positions.copy()
        self.assertIn("closed", repr(file))
        with self.assertRaisesRegex(lodpack.QueryError, "closed"):
            file.extract()
        del file
        np.testing.assert_array_equal(mesh.positions, before)

    def test_each_culprit_has_its_exception(self):
        damaged = bytearray(SMALL.read_bytes())
        damaged[len(damaged) // 2] ^= 1
        newer = (VECTORS / "invalid" / "newer_version.lodpack").read_bytes()
        text = tempfile.TemporaryFile("w+")
        cases = [
            (FileNotFoundError, "No such file", "nowhere.lodpack"),
            (IsADirectoryError, "name a .lodpack file", str(SMALL.parent)),
            (lodpack.FormatError, "not a lodpack file", __file__),
            (lodpack.FormatError, "shorter than a header", b""),
            (lodpack.FormatError, "truncated|shorter|damaged", SMALL.read_bytes()[:200]),
            (lodpack.UnsupportedError, "newer lodpack", newer),
            (lodpack.SourceError, "no-such-scheme", "no-such-scheme://host/scan.lodpack"),
            (TypeError, "mode 'rb'", text),
            (TypeError, "int", 5),
        ]
        for kind, message, source in cases:
            with self.subTest(message), self.assertRaisesRegex(kind, message) as raised:
                lodpack.open(source)
            self.assertIsInstance(raised.exception, lodpack.Error)
            again = pickle.loads(pickle.dumps(raised.exception))
            self.assertEqual((type(again), str(again)), (type(raised.exception), str(raised.exception)))
        with self.assertRaisesRegex(lodpack.FormatError, "checksum"):
            lodpack.open(bytes(damaged)).verify()
        with self.assertRaisesRegex(lodpack.QueryError, "timeout"):
            lodpack.open(SMALL, timeout=float("nan"))
        with self.assertRaisesRegex(lodpack.QueryError, "part_bytes"):
            lodpack.open(SMALL, limits={"roots": 3})
        for options in [{"timeout": "soon"}, {"timeout": -1}, {"limits": 3}, {"limits": {"root_count": "few"}}, {"limits": {"root_count": -1}}, {"limits": {5: 5}}]:
            with self.subTest(options), self.assertRaises(lodpack.QueryError):
                lodpack.open(SMALL, **options)
        for path in ["a\0b", b"bytes", SMALL / "below"]:
            with self.subTest(path), self.assertRaises(lodpack.Error):
                lodpack.open(path)
        with self.assertRaisesRegex(lodpack.LimitError, "above the limit of 1"):
            lodpack.open(SMALL, limits={"root_count": 1})
        text.close()

    def test_servers_that_fail_are_named_with_what_they_did(self):
        with served(SCAN.read_bytes(), ranges_work=False) as (url, _):
            with self.assertRaisesRegex(lodpack.SourceError, "ignores range requests") as raised:
                lodpack.open(url)
            self.assertIsInstance(raised.exception, OSError)
        with socket.socket() as unused:
            unused.bind(("127.0.0.1", 0))
            with self.assertRaisesRegex(lodpack.SourceError, "cannot connect"):
                lodpack.open(f"http://127.0.0.1:{unused.getsockname()[1]}/scan.lodpack")

    def test_what_a_python_file_raises_is_the_cause(self):
        class Broken(io.BytesIO):
            def read(self, size=-1):
                raise ConnectionResetError("the cable is out")

        with self.assertRaisesRegex(lodpack.SourceError, "the cable is out") as raised:
            lodpack.open(Broken(b"x" * 10_000))
        self.assertIsInstance(raised.exception.__cause__, ConnectionResetError)

    def test_ctrl_c_ends_the_wait_for_a_server(self):
        with socket.socket() as silent:
            silent.bind(("127.0.0.1", 0))
            silent.listen()
            address = f"http://127.0.0.1:{silent.getsockname()[1]}/scan.lodpack"
            program = f"import lodpack, signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\nprint('opening', flush=True)\nlodpack.open({address!r})"
            child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            child.stdout.readline()
            connection, _ = silent.accept()
            with connection:
                child.send_signal(signal.SIGINT)
                # A request alone would take 30 seconds.
                _, said = child.communicate(timeout=20)
        self.assertIn("KeyboardInterrupt", said)

    def test_other_threads_go_on_while_one_waits(self):
        with socket.socket() as silent:
            silent.bind(("127.0.0.1", 0))
            silent.listen()
            address = f"http://127.0.0.1:{silent.getsockname()[1]}/scan.lodpack"

            def open_in_vain():
                with contextlib.suppress(lodpack.SourceError):
                    lodpack.open(address, timeout=0.5)

            thread = threading.Thread(target=open_in_vain)
            thread.start()
            connection, _ = silent.accept()
            with connection:
                # With the interpreter's lock held, this would come after the thread's end.
                self.assert_same(lodpack.open(SMALL))
                self.assertTrue(thread.is_alive())
                thread.join()


def required(name):
    """A library that the run installs."""
    return __import__(name)
