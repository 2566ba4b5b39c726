"""A convoy on several hosts: network namespaces, and a cable that fails."""
