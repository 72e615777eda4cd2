"""Certificates for one test: an authority, a listener on 127.0.0.1, one who connects, and a stranger's."""

from pathlib import Path

import trustme


def write_certificates(folder: Path) -> None:
    """Write the files that the examples in data/zenoh name, and `stranger.*` of another authority."""
    authority, other = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(str(folder / "ca.pem"))
    other.cert_pem.write_to_path(str(folder / "stranger-ca.pem"))
    _write(authority.issue_cert("127.0.0.1", common_name="learner"), folder, "listen")
    _write(authority.issue_cert("replay.test", common_name="replay"), folder, "connect")
    _write(other.issue_cert("replay.test", common_name="replay"), folder, "stranger")


def _write(certificate: trustme.LeafCert, folder: Path, name: str) -> None:
    certificate.private_key_pem.write_to_path(str(folder / f"{name}.key"))
    certificate.cert_chain_pems[0].write_to_path(str(folder / f"{name}.pem"))
