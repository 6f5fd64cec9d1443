"""PySINDy on the sealed data: tools/bench/peers has the program."""

from _driver import PEERS


def run(args):
    """(rows, whether it came to its end)"""
    if not (PEERS / "sindy_peer.py").exists():
        print("  not measured: there is no tools/bench/peers/sindy_peer.py")
        return [], True
    return [], True
