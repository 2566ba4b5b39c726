"""Tests in containers; skipped without a container engine."""
