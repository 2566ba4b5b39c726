"""One run of a scenario: in processes over Zenoh, or in virtual time."""
