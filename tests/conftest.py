"""What tests of several modules are given."""

import sys

import pytest

from deformer_app import cli, console


@pytest.fixture
def run(capfd, monkeypatch):
    """Run the command in this process; gives (status, stdout, stderr)."""

    def call(*arguments):
        texts = [str(argument) for argument in arguments]
        monkeypatch.setattr(sys, "argv", ["deformer", *texts])
        capfd.readouterr()
        status = console.run(cli.app, texts)
        return status, *capfd.readouterr()

    return call
