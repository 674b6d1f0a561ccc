"""The scaled motion during an impact, its end, and the quantities watched during a solve."""
