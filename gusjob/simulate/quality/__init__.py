"""Quality of marks: the error of their ends and corners, and the evenness of their energy."""
