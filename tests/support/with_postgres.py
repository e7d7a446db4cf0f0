"""A PostgreSQL server for the tests of one class."""

import os
import pathlib
import subprocess
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).with_name("private_postgres.sh")
NOT_INSTALLED = 77


class WithPostgres(unittest.TestCase):
    """With a PostgreSQL server of its own, in which LUMIFOLD_STORE names a database."""

    @classmethod
    def postgres_command(cls):
        return (SCRIPT,)

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.postgres = subprocess.Popen(cls.postgres_command(),
                                        stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE,
                                        text=True)
        cls.uri = cls.postgres.stdout.readline().strip()
        if not cls.uri:
            if cls.postgres.wait() == NOT_INSTALLED:
                raise unittest.SkipTest("PostgreSQL is not installed (deploy/setup.sh --tests)")
            raise AssertionError("PostgreSQL does not start")
        os.environ["LUMIFOLD_STORE"] = cls.uri

    @classmethod
    def tearDownClass(cls):
        del os.environ["LUMIFOLD_STORE"]  # the next class may be without
        cls.postgres.communicate()  # it ends with its input
        cls.folder.cleanup()
