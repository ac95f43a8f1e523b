"""Where the work of a study runs: processes, clusters, versions, digests."""
