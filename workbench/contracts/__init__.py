"""Contract tests for components: pytest --pyargs workbench.contracts --component-package my_components."""
