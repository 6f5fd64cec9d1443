"""tiller tune: settings of a robot file by the return of episodes on its simulated plant (docs/guide/tune.md)."""
