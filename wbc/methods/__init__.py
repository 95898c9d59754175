"""The methods: each as a closed form and as a QP. Arrays in, arrays out; no robot is needed. One file, one line."""
