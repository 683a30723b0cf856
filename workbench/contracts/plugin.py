"""The option of pytest that names the package whose parts are to be tested."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --component-package."""
    parser.addoption(
        "--component-package", metavar="PACKAGE", help="test the components of this package against workbench.contracts"
    )
