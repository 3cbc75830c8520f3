"""What a policy is run against."""
