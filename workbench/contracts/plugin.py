"""The option of pytest that names the package whose parts are to be tested."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --parts."""
    parser.addoption("--parts", metavar="PACKAGE", help="test the parts of this package against workbench.contracts")
