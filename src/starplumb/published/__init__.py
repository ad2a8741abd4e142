"""The published tables recomputed: scenarios and figures as data, one module for each family of tables.

``paper2019.toml`` and ``slides2012.toml`` hold the scenarios, every assumption the documents leave open under a key of
its own; ``tables/`` the printed figures with their source.
"""
