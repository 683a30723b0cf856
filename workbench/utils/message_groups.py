"""Log messages that differ in their values alone, as one message."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class _Collector(logging.Handler):
    """Messages by their text before values are inserted."""

    def __init__(self) -> None:
        super().__init__()
        self.kinds: dict[str, list[logging.LogRecord]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.kinds.setdefault(str(record.msg), []).append(record)


@contextmanager
def grouped_messages(name: str) -> Iterator[None]:
    """Log the messages of the logger `name` and of those below it after the block, each kind once.

    Messages are of one kind if they have the same text before their values are inserted. The first one of each kind is
    logged, with the number of the others.
    """
    logger, collector = logging.getLogger(name), _Collector()
    propagate = logger.propagate
    logger.addHandler(collector)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagate
        for records in collector.kinds.values():
            others = f"; likewise {len(records) - 1} more" if len(records) > 1 else ""
            logging.getLogger(records[0].name).log(records[0].levelno, "%s%s", records[0].getMessage(), others)
