"""A process that does job after job holds no more memory after many than after a few."""

import pytest
from small_jobs import KINDS, memory_held

SHORT = tuple(kind for kind in KINDS if kind.__name__ in ("views", "voxels", "curve", "terrain"))


@pytest.mark.slow
def test_sixty_jobs_in_one_process_hold_no_more_than_twenty():
    (_, few, _), (_, many, _) = memory_held(SHORT, (20, 60))
    assert many < 1.05 * few
