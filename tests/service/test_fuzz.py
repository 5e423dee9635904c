"""Requests made from the OpenAPI description, sound and unsound: no answer is a fault of the service (status 500)."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.service.serving import serving

_EXAMPLES = 6


@pytest.mark.long
def test_no_request_makes_the_service_fail(tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service:
        lease = service.ask("POST", "/api/lease", json={"holder": "fuzz", "seconds": 600}).json()["lease"]
        done = subprocess.run(
            [
                *(sys.executable, "-m", "schemathesis.cli", "run", f"{service.url}openapi.json"),
                *("--header", f"Authorization: Bearer {service.token()}", "--header", f"X-Lease: {lease}"),
                *("--checks", "not_a_server_error", "--phases", "fuzzing", "--mode", "all"),
                *("--max-examples", str(_EXAMPLES), "--seed", "1", "--no-color"),
                *("--generation-deterministic", "--suppress-health-check", "all", "--request-timeout", "60"),
            ],
            capture_output=True,
            text=True,
            timeout=280,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
        assert "Test cases" in done.stdout or "generated" in done.stdout
        assert service.ask("GET", "/healthz").status_code == 200
