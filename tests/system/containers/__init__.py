"""Tests in containers, where there is an engine that runs them."""
