"""Messages of one kind are logged once, with the number of the others."""

import logging

import pytest

from workbench.utils.message_groups import grouped_messages


def test_each_kind_of_message_is_logged_once(caplog):
    log = logging.getLogger("workbench.motion.formats.bvh")
    with grouped_messages("workbench.motion"):
        for k in range(80):
            log.warning("%s: read in cm", f"clip_{k}.bvh")
        log.warning("%s: %d roots", "clip_7.bvh", 2)
        assert not caplog.messages
    assert caplog.messages == ["clip_0.bvh: read in cm; likewise 79 more", "clip_7.bvh: 2 roots"]


def test_messages_before_an_error_are_logged_and_later_ones_are_not_held_back(caplog):
    log = logging.getLogger("workbench.motion.formats.bvh")

    def fail():
        with grouped_messages("workbench.motion"):
            log.warning("first")
            raise OSError("disk")

    with pytest.raises(OSError, match="disk"):
        fail()
    log.warning("second")
    assert caplog.messages == ["first", "second"]
