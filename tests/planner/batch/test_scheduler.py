"""A Dask scheduler as an executor: one that answers, one that does not, and none at all."""

import gc

import pytest

from planner import RequestError
from planner.app import batch as scheduler
from planner.app.batch import dask_executor


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere:nothing"])
def test_a_scheduler_that_does_not_answer_is_told_with_its_address(monkeypatch, address):
    pytest.importorskip("distributed")
    monkeypatch.setattr(scheduler, "_ANSWERS_S", 0.2)
    with (
        pytest.raises(RequestError, match=f"scheduler that answers.*Got '{address}'"),
        dask_executor(address),
    ):
        pass
    # Dask closes a client that failed when it is collected as garbage, which in another client's loop would wait for it
    gc.collect()


def test_without_dask_it_is_said_how_to_get_it(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(scheduler, "import_module", missing)
    with (
        pytest.raises(ImportError, match=r"pip install '\.\[dask\]'"),
        dask_executor("tcp://host:8786"),
    ):
        pass


def test_work_is_done_by_its_workers():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
        ) as cluster,
        dask_executor(cluster.scheduler_address) as executor,
    ):
        assert executor.submit(pow, 3, 4).result(timeout=30) == 81
        assert list(executor.map(abs, [-1, 2, -3])) == [1, 2, 3]
