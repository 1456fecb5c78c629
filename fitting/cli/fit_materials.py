"""`suas fit materials`: many membranes, on this machine or on a cluster."""

from pathlib import Path
from typing import Annotated

from fitting.cli.contract import bad_input
from fitting.cli.options import ManyWorkers, TrustNetwork, argument, executor, output_option
from fitting.cli.progress import bar
from suas_jax.acquisition.terminal import say


def materials(
    jobs: Annotated[Path, argument("TOML file with a table `membrane` for each membrane.")],
    output: Annotated[
        Path,
        output_option("Results as JSON lines; membranes that are in the file are skipped."),
    ],
    workers: ManyWorkers = "2",
    trust_network: TrustNetwork = False,
) -> None:
    """Calibrate many membranes at once; repeat the command to resume.

    Exit status: 0 every membrane has a line of results (its status says how it went),
    2 bad input, or a membrane's worker processes died.
    """
    with bad_input():
        from fitting.material.many import calibrate_all, load_jobs

        wanted = load_jobs(jobs)
        with (
            executor(workers, trust_network) as processes,
            bar("calibrating membranes", len(wanted)) as advance,
        ):
            assert processes is not None
            added = calibrate_all(wanted, output, processes, lambda done, *_: advance(done))
    say(f"{added} results added to {output}", err=True)
