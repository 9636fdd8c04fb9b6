"""What the benchmarks of the missing piece share: broken vessels, their walls as one mesh, programs that fill holes."""
