"""What several tests share: boards, scenes, oracles, running the command."""
