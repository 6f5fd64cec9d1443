"""Reports of tiller's runs and fits: CSV in, one HTML file out, nothing fetched from the network."""
