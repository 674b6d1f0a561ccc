"""The scaled motion during an impact, its ends, and what a solve watches."""
