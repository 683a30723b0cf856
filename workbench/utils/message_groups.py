"""Log messages that differ in their values alone, as one message."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def grouped_messages(name: str) -> Iterator[None]:
    """Log the messages of the logger `name` and of those below it after the block, each kind once.

    Messages are of one kind if they have the same text before their values are inserted. The first one of each kind is
    logged, with the number of the others.
    """
    logger, kinds = logging.getLogger(name), dict[str, list[logging.LogRecord]]()
    handler, propagate = logging.Handler(), logger.propagate
    handler.emit = lambda record: kinds.setdefault(str(record.msg), []).append(record)  # type: ignore[method-assign]
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate
        for records in kinds.values():
            others = f"; likewise {len(records) - 1} more" if len(records) > 1 else ""
            logging.getLogger(records[0].name).log(records[0].levelno, "%s%s", records[0].getMessage(), others)
