"""The paper's claims and figures as pages and plots."""
