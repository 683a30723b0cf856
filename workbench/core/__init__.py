"""The seams of the workbench: what the parts of a run hand to each other. Terms: docs/glossary.md."""
