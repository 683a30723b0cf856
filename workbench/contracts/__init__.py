"""What every part keeps, as tests that run on anybody's: pytest --pyargs workbench.contracts --parts my_parts."""
